"""The paper's method: Algorithm 1 and its steps, Eq. 6, 7 and 8."""
