# What haptune uses of scikit-learn, whose types are partly unknown.
from contextlib import AbstractContextManager

def config_context(*, skip_parameter_validation: bool) -> AbstractContextManager[None]: ...
