"""The pass over logs on several machines: files become runs where they lie, and what is left of them is joined."""
