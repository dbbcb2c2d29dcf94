"""What the U-Net is compared with: a linear map, and proper orthogonal decomposition."""
