"""The joint method: shading and motion in one Gauss-Newton system."""
