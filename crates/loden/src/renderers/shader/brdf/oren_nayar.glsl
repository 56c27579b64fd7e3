// Diffuse reflection of a rough surface; sigma is the deviation of its slope in degrees.
float oren_nayar(float sigma, vec3 wi, vec3 wo) {
    float spread = sigma * PI / 180.0;
    float s = spread * spread;
    float along = max(wi.x * wo.x + wi.y * wo.y, 0.0);
    return (1.0 - 0.5 * s / (s + 0.33) + 0.45 * s / (s + 0.09) * along / max(max(wi.z, wo.z), 1e-6)) / PI;
}
