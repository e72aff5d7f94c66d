"""Many scenes, one command: solved on a cluster, each in a process of its own, recorded one row a scene."""
