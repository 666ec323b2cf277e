"""What is computed: one file per kind of cube, with labels, tiles, their cost, and a warm-up."""
