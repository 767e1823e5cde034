"""What a part is made of: bodies that know how deep a place is in them."""
