// A Gaussian of the slope of the half vector, with bounded energy.
float ward_lobe(float alpha_x, float alpha_y, vec3 wi, vec3 wo) {
    vec3 h = wi + wo;
    float x = h.x / alpha_x;
    float y = h.y / alpha_y;
    float z = max(h.z * h.z, 1e-12);
    float gauss = exp(max((x * x + y * y) / (0.0 - z), -80.0)) / (PI * alpha_x * alpha_y);
    return gauss * dot(h, h) / (z * z);
}
