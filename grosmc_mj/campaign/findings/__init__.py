"""What rows say: rates and intervals, differences, sensitivities, worst plants and radii."""
