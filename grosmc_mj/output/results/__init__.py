"""Form of results: tables, figures and their style, colours, JSON documents."""
