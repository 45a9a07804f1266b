"""Recordings of a payload with something wrong in the wrench, made without any code of the tool."""
