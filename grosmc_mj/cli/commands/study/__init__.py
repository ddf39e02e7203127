"""The studies: what one command measures beyond the chapter's cases."""
