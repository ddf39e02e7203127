"""What a case file may say, and how it is read: tables, units, formulas, the user's Python."""
