"""Many scenes, one command: solved on a cluster, each in a process of its own, recorded as one row per scene."""
