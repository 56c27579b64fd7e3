// A power of the cosine between half vector and normal.
float blinn_phong_lobe(float exponent, vec3 wi, vec3 wo) {
    float factor = (exponent + 2.0) * (exponent + 4.0) / (8.0 * PI * (pow(2.0, -0.5 * exponent) + exponent));
    return factor * pow(max(half_vector(wi, wo).z, 1e-30), exponent);
}
