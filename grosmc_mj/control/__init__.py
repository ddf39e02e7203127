"""The chapter's theory, without a physics engine."""
