"""The chapter's claims and figures, and the results that the repository records.

``claims`` holds the claims with their expected verdicts, and the measurements that judge them.
"""
