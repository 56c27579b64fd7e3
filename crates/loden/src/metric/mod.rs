//! What a compression cost: errors over all texels, channels and pairs.
