"""What closes a room where nobody looked: continued from what was seen, and never mixed with it."""
