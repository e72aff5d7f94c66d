"""A layout against depth maps and true planes, for scenes that have them."""
