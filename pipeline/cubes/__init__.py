"""What is computed: a file per kind of cube, with its labels, its tiles, their cost, its warm-up.

Each function that a command calls here returns a `Job`; nothing is computed before it is swept.
"""
