"""What a face is: the B-spline surface, its template and its prior (section 2.1)."""
