"""The pictures, curves and pages that show results."""
