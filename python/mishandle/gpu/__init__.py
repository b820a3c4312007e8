"""The device ``gpu``: worlds, networks and cameras on an NVIDIA GPU."""
