"""The input of stage 4: a scene in canonical form, and the results of stages 1 to 3 in it."""
