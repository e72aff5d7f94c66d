"""After stage 5: what was measured by hand joins what was seen. Each measurement is one more factor on all planes."""
