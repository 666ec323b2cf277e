"""The kinds of cubes, one file for each: its labels, its tiles and their cost, and a warm-up."""
