"""Sans-I/O codecs of the three protocols: bytes out, bytes in, no port and no clock."""
