"""What a shape is made of: rigid motions, strain of members and parts, motion as one beam."""
