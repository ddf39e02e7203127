"""The chapter's claims: one module a system has their measures, ``ledger`` all of them."""
