"""What the page tells of studies, sweeps and premises: documents, their answers, their sheets."""
