"""Form of results: tables, JSON documents, texts of pages in Markdown."""
