"""Logs that must be refused or doubted, three for every finding: ``cases.cases(seed)``."""
