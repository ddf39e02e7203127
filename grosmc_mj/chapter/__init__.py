"""What the chapter says and what is recorded of it.

``claims`` has its claims with the expected verdicts and measures them; the rest are the claims as
document, tables, figures and page, the chapter's figures, and the expected results.
"""
