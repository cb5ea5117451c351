"""JSON documents in and out, sealed ones among them."""
