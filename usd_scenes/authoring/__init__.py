"""The example scenes: surfaces from Warp kernels, written as USD animations."""
