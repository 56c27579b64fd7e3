// A cosine lobe about a generalised mirror direction.
float lafortune_lobe(vec3 c, float exponent, vec3 wi, vec3 wo) {
    float cosine = dot(c * wi, wo);
    return cosine > 0.0 ? (exponent + 2.0) / (2.0 * PI) * pow(max(cosine, 1e-30), exponent) : 0.0;
}
