"""How results look: tables, the style of figures, colours, JSON documents."""
