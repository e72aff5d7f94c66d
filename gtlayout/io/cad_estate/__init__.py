"""Clips as in the CAD-Estate release: cameras, masks, published layouts."""
