"""How far surfaces are from flat: what their tracks show beyond their noise, and what DIN 18202 permits."""
