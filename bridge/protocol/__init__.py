"""Sans-I/O codecs of the three protocols: bytes in, bytes out, without a port or a clock."""
