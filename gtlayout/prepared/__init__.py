"""What stage 4 works on: a scene in canonical form, and what stages 1 to 3 measured in it."""
