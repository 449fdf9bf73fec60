// Whether the front of a pixel hides something of ours, in the sign of its Σw: what a soft rim lets through is then not
// the background. A bit, not a minus: the sign of nothing counts too.
float with_hidden(float weight, bool hidden) {
    return uintBitsToFloat(floatBitsToUint(weight) | (hidden ? 0x80000000u : 0u));
}

bool is_hidden(float weight) {
    return floatBitsToUint(weight) >> 31 != 0u;
}
