"""The sparse regression of pysindy, from backward steps to the terms that pay for themselves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

#: Size of the anchor's column and answer: dropping it would cost this much squared, more than any
#: other term, so pysindy never empties the model and never spends a step on the anchor.
_ANCHOR = 1e3


def paying_terms(whitened: FloatArray, answers: FloatArray, price: float) -> BoolArray:
    """Which terms each answer asks for, by stepwise sparse regression.

    pysindy's SSR (Boninsegna, Nüske, Clementi, Journal of Chemical Physics 148, 2018, 241723)
    drops one term after the other, always the one that is missed least, and keeps the model with
    the least χ² + price · terms on the way.

    Args:
        whitened: shape (rows, p), columns of the terms in rows whose errors are independent with
            variance 1, so that a rise of the squared residual is the χ² of what was dropped.
        answers: shape (rows, r), the same rows of r data sets.
        price: the rise of χ² a term must be worth, a squared number of standard deviations.

    Returns:
        Shape (r, p).
    """
    from pysindy import SSR
    from sklearn import config_context

    rows, count = whitened.shape
    # Columns of unit norm for the solver's sake. pysindy always keeps one term: the anchor, which
    # stands for mass and damping.
    columns = np.zeros((rows + 1, count + 1))
    columns[:rows, :count] = whitened / np.linalg.norm(whitened, axis=0)
    columns[rows, count] = 1.0
    anchor = _ANCHOR + np.linalg.norm(answers, axis=0)
    anchored = np.vstack((answers, anchor))
    # Without a charge of its own pysindy notes the squared residual of every model on the way. Its
    # own charge counts coefficients that are not zero, so a term whose coefficient happens to be
    # exactly zero would come free, and the model that holds it would be the best.
    search = SSR(alpha=0.0, kappa=0.0, criteria="model_residual", max_iter=count + 1, unbias=False)
    charges = price * np.arange(count, -1, -1, dtype=np.float64)
    chosen = np.zeros((answers.shape[1], count), dtype=bool)
    # scikit-learn, on which pysindy rests, would spend half of the time on checking arguments.
    with config_context(skip_parameter_validation=True):
        for index, answer in enumerate(anchored.T):
            search.fit(columns, answer[:, None])
            best = int(np.argmin(np.add(search.err_history_, charges)))
            # pysindy 2.1 overwrites the coefficients of the first model, the one with every term,
            # while it drops terms.
            chosen[index] = best == 0 or search.history_[best][0, :count] != 0
    return chosen
