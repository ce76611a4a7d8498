"""What maintainers run: benchmarks, and tools that make or check parts of the product."""
