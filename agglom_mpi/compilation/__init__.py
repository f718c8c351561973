"""Kernels: how their stages are declared, chosen by a scene's laws, compiled, linked and cached."""
