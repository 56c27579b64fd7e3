// A power of the cosine to the mirror direction.
float phong_lobe(float exponent, vec3 wi, vec3 wo) {
    float cosine = dot(vec3(0.0 - wi.x, 0.0 - wi.y, wi.z), wo);
    return cosine > 0.0 ? (exponent + 2.0) / (2.0 * PI) * pow(max(cosine, 1e-30), exponent) : 0.0;
}
