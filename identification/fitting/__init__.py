"""From a log to the estimate believed: choice of method and terms."""
