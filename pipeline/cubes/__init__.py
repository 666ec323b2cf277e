"""Kinds of cubes: each module defines the labels, tiles, costs and warm-up of one kind."""
