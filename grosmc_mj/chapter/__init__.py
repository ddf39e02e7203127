"""The chapter's claims and figures, and the results that the repository records.

``claims`` holds the claims with their expected verdicts, and the measurements that judge them;
``validation`` compares runs with the recorded results. It imports studies and below.
"""
