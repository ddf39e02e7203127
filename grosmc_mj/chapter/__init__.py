"""What the chapter says and what is recorded of it.

Its figures, the expected results and verdicts, its claims as document, tables, figures and page;
``claims`` measures them.
"""
