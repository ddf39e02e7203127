"""The chapter's cases, what is measured on them, and how it is reported."""
