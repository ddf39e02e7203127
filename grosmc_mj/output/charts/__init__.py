"""Charts of answers: figures and their style, charts of a result, ranges of fast signals."""
