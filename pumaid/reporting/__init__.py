"""Records made visible: tables, figures, the report page; nothing here fits, and nothing here writes a file."""
