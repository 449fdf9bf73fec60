// w(u) = 2^(−4u²), MODEL: half at half the radius, 1/16 at the rim. Discs and pixels weigh 1.
float weight(float u2) {
    return FOOTPRINT == FOOTPRINT_SPLAT ? exp2(-4.0 * u2) : 1.0;
}
