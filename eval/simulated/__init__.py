"""Rooms without images, whose tracks and edges are made from known planes; and scenes that are broken on purpose."""
