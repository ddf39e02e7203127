"""Results of a campaign as a document, tables and figures."""
