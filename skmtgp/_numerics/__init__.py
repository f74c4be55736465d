"""Linear algebra, optimisation, threads and memory."""
