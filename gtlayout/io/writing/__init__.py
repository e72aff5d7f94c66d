"""Scene folders, in any of the formats that are read."""
