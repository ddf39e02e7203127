"""Thousands of uncertain plants: what share of them keeps what is required.

``family`` says which plants, ``runs`` runs them, ``findings`` says what the rows mean, ``report``
shows it.
"""
