"""GTSAM custom factors of gtlayout."""
