"""Solvers: motion from landmarks, the joint system, the methods of the paper."""
