"""What people have found: markers, told to other programs and reported."""
