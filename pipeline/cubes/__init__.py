"""What is computed: a file per kind of cube, with its labels, tiles, their cost, its warm-up."""
