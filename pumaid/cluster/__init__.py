"""The pass over logs by several processes, here or elsewhere: pieces become runs where they lie and are joined."""
