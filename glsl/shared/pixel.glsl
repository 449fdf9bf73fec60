// Where a point appears, to a millionth of a pixel in any picture: f32 alone is off by 10⁻⁴ px in one 2000 px wide, and
// weights of small footprints by six times that. The matrix is split on the CPU (src/draw/split.rs) so that the products
// and sums of `hi` are exact; `precise` keeps the compiler from taking the splits apart again.
// Without PAIRS, in pictures so small that the first is good enough, all of the image is in `whole`: the pairs cost a tenth
// of the splat passes on lavapipe.

// The nearest whole pixel to the image of `position` (cloud coordinates; `centre` in eye space) and the rest, from the
// picture's middle; w.
void pixel_of(vec3 position, vec3 centre, out vec2 whole, out vec2 rest, out float w) {
    if (!PAIRS) {
        vec4 c = vec4(centre, 1.0);
        w = dot(params.pixel_w, c);
        whole = vec2(dot(params.pixel_x, c), dot(params.pixel_y, c)) / w;
        rest = vec2(0.0);
        return;
    }
    precise vec3 from = position - params.about.xyz;
    precise vec3 coarse = (from + params.about.w) - params.about.w;
    precise vec3 fine = position - (params.about.xyz + coarse);
    precise vec3 hi = vec4(coarse, 1.0) * params.pixel_hi;
    precise vec3 lo = vec4(fine, 0.0) * params.pixel_hi + vec4(from, 1.0) * params.pixel_lo;
    w = hi.z + lo.z;
    whole = floor((hi.xy + lo.xy) / w + 0.5);
    // Eleven bits of w at a time: with the 13 of a pixel's number the product is exact.
    precise float w_head = uintBitsToFloat(floatBitsToUint(hi.z) & 0xffffe000u);
    precise vec2 left = ((hi.xy - whole * w_head) - whole * (hi.z - w_head)) + (lo.xy - whole * lo.z);
    rest = left / w;
}
