// From a stored splat to its image: what is drawn, where, and what a fragment needs to find the disk again.
//
// A point of the disk is c + r (a t1 + b t2), a² + b² ≤ 1. With v the direction from the eye to c, t1 = n × v is the long
// axis of the image and m = v × t1 completes the frame across the ray, so that t2 · m = n · v is the foreshortening, free
// of cancellation. J(t) is the derivative of the pixel, times w, when c moves along t; J(v) = 0, hence
// J(t2) = (n · v) J(m). A fragment at offset d from the projected centre sees
//     a = W/r (d × J(m)) / (J(t1) × J(m)),   b = W/(r n·v) (J(t1) × d) / (J(t1) × J(m)),   W = w + r (a w1 + b w2),
// where w1 and w2 are the derivatives of w. Setting W = w gives the affine image (a0, b0); exactly,
//     (a, b) = (a0, b0) / (1 − (a0, b0) · h),   h = r (w1, w2) / w.
// No determinant of a conic is ever formed or divided by.
#include "params.glsl"
#include "packing.glsl"
#include "pixel.glsl"
#include "interval.glsl"
#include "layered.glsl"
#include "tolerance.glsl"

const uint DRAWN = 0u;      // a sprite holds it
const uint TOO_LARGE = 1u;  // drawn as a quad whose fragments cast their ray in eye space
const uint OUTSIDE = 2u;    // its footprint misses the picture or lies before the near plane
const uint BACK_FACE = 3u;
const uint INVALID = 4u;
const uint NOT_IN_CUT = 5u; // a finer or coarser point stands for it

struct Splat {
    uint status;
    vec3 centre;    // eye space
    vec3 normal;    // eye space, unit, towards the viewer
    float radius;   // [world units]
    float epsilon;  // depth tolerance [world units]
    float depth;    // linear
    vec2 pixel;     // of the centre, from the picture's middle; far outside where that is before the near plane
    vec2 whole;     // the same in whole pixels, and the rest
    vec2 rest;
    vec4 inverse;   // rows of the matrix that takes d to (a0, b0)
    vec2 slope;     // depth along r t1 and r t2
    vec4 box;       // min and max [px] of the footprint within the picture, from its middle
};

// Where the line t + u·across meets the unit circle, across a unit normal's direction `along`: no angles, since the
// inverse trigonometric functions are only good for some 10⁻⁴.
vec2 on_circle(vec2 along, float t, float side) {
    float c = clamp(t / max(length(along), 1e-37), -1.0, 1.0);
    vec2 d = along / max(length(along), 1e-37);
    return c * d + side * sqrt(1.0 - c * c) * vec2(-d.y, d.x);
}

// Grows the box by the pixel of the rim's point c + e1 rim.x + e2 rim.y, if it lies beyond `least`.
void grow(inout vec4 box, vec3 c, vec3 e1, vec3 e2, vec2 rim, float least) {
    vec3 p = c + e1 * rim.x + e2 * rim.y;
    float z = -p.z;
    if (z >= least) {
        p.z = -max(z, params.near);
        vec4 h = vec4(p, 1.0);
        vec2 at = vec2(dot(params.pixel_x, h), dot(params.pixel_y, h)) / dot(params.pixel_w, h);
        box = vec4(min(box.xy, at), max(box.zw, at));
    }
}

// Exact box of the part of the disk that lies beyond the near plane: its extremes are the ends of the chord in that plane,
// and the rim's points where x/w or y/w is stationary. With x = x0 + xa cos φ + xb sin φ, and w likewise, those fulfil
// (xb w0 − x0 wb) cos φ + (x0 wa − xa w0) sin φ = xa wb − xb wa.
vec4 clipped_box(vec3 c, vec3 e1, vec3 e2) {
    vec4 box = vec4(1e30, 1e30, -1e30, -1e30);
    vec2 slope = -vec2(e1.z, e2.z);
    vec3 w = vec3(dot(params.pixel_w, vec4(c, 1.0)), dot(params.pixel_w.xyz, e1), dot(params.pixel_w.xyz, e2));
    // Only ratios matter: products of four such numbers must not leave the range of floats.
    w /= max(max(abs(w.x), abs(w.y)), max(abs(w.z), 1e-37));
    for (float side = -1.0; side < 2.0; side += 2.0) {
        // Rounding must not lose an end of the chord: it lies in the plane, whatever was computed.
        grow(box, c, e1, e2, on_circle(slope, params.near + c.z, side), -1e30);
        for (int axis = 0; axis < 2; axis++) {
            vec4 row = axis == 0 ? params.pixel_x : params.pixel_y;
            vec3 x = vec3(dot(row, vec4(c, 1.0)), dot(row.xyz, e1), dot(row.xyz, e2));
            x /= max(max(abs(x.x), abs(x.y)), max(abs(x.z), 1e-37));
            vec2 along = vec2(x.z * w.x - x.x * w.z, x.x * w.y - x.y * w.x);
            grow(box, c, e1, e2, on_circle(along, x.y * w.z - x.z * w.y, side), params.near);
        }
    }
    return box;
}

// `i` is the point's number in its chunk.
Splat project(uint i, Point point) {
    vec4 geometry = point.geometry;
    bool there = !LAYERED || in_layers(i, geometry);
    Splat s;
    s.status = INVALID;
    // Squares of radii must not leave the range of floats: smaller and larger disks are points and planes.
    s.radius = clamp(max(geometry.w, run.least) * params.radius_scale, 1e-18, 1e18);
    s.centre = vec4(geometry.xyz - params.about.xyz, 1.0) * params.eye_from_cloud;
    s.depth = -s.centre.z;
    s.normal = vec3(0.0, 0.0, 1.0);
    s.pixel = vec2(-1e15);
    s.whole = s.pixel;
    s.rest = vec2(0.0);
    s.inverse = vec4(0.0);
    s.slope = vec2(0.0);
    s.epsilon = 0.0;
    s.box = vec4(0.0);
    // Also false for NaN; infinities fail the upper bounds. The stored radius is asked, since a product may be flushed to 0.
    bool sized = geometry.w > 0.0 && !isinf(geometry.w) && params.radius_scale > 0.0;
    if (!(sized && dot(abs(s.centre), vec3(1.0)) < 1e30)) {
        return s;
    }
    if (!(there && in_interval(i, geometry.xyz))) {
        s.status = NOT_IN_CUT;
        return s;
    }

    vec3 v = normalize(PERSPECTIVE ? s.centre - params.eye.xyz : -params.eye.xyz);
    s.normal = -v;
    if (HAS_NORMAL && point.normal != NO_NORMAL) {
        s.normal = normalize(vec4(octahedral(point.normal), 0.0) * params.eye_from_cloud);
        if (dot(s.normal, v) > 0.0) {
            if (CULL_BACK) {
                s.status = BACK_FACE;
                return s;
            }
            s.normal = -s.normal;
        }
    }

    s.status = OUTSIDE;
    float w = 1.0;
    bool centre_visible = s.depth >= params.near;
    if (centre_visible) {
        pixel_of(geometry.xyz, s.centre, s.whole, s.rest, w);
        s.pixel = s.whole + s.rest;
    }
    if (FOOTPRINT == FOOTPRINT_PIXELS) {
        if (!centre_visible) {
            return s;
        }
        s.box = vec4(s.pixel - 0.5 * params.pixel_size, s.pixel + 0.5 * params.pixel_size);
    } else {
        vec3 across = cross(s.normal, v);
        // Below 10⁻⁴ rad of tilt the axes are noise; the disk is taken as facing the eye (depth error 10⁻⁴ r).
        if (dot(across, across) < 1e-8) {
            s.normal = -v;
            across = cross(v, abs(v.x) < 0.5 ? vec3(1.0, 0.0, 0.0) : vec3(0.0, 1.0, 0.0));
        }
        vec3 t1 = normalize(across);
        vec3 t2 = cross(s.normal, t1);
        vec3 m = cross(v, t1);
        float nv = min(dot(s.normal, v), -1e-6);
        s.slope = -s.radius * vec2(t1.z, t2.z);
        s.epsilon = tolerance(s.radius, 0.0, nv);
        float reach = length(s.slope);
        if (s.depth + reach < params.near) {
            return s;
        }
        // A footprint that comes close to the eye is cast in eye space, where 1 − (a0, b0) · h would cancel; the affine form
        // has no such term.
        bool near_eye = s.depth - reach < max(params.near, PERSPECTIVE && !APPROXIMATE ? 0.1 * s.depth : params.near);
        // Sprites leave those to the quads. Software devices run both sides of a branch, so this is a constant's.
        if (near_eye && !CASTS) {
            s.status = TOO_LARGE;
            return s;
        }
        // Only a disk that reaches the near plane has no bounded image: the part beyond that plane has.
        bool clipped = CASTS && s.depth - reach < max(params.near, PERSPECTIVE && !APPROXIMATE ? 1e-3 * s.depth : params.near);
        if (clipped) {
            s.box = clipped_box(s.centre, s.radius * t1, s.radius * t2);
        }
        if (centre_visible) {
            vec2 j1 = vec2(dot(params.pixel_x.xyz, t1), dot(params.pixel_y.xyz, t1)) - s.pixel * dot(params.pixel_w.xyz, t1);
            vec2 jm = vec2(dot(params.pixel_x.xyz, m), dot(params.pixel_y.xyz, m)) - s.pixel * dot(params.pixel_w.xyz, m);
            float area = j1.x * jm.y - j1.y * jm.x;
            float f = w / (s.radius * area);
            s.epsilon = tolerance(s.radius, w * inversesqrt(abs(area)), nv);
            s.inverse = f * vec4(jm.y, -jm.x, -j1.y / nv, j1.x / nv);
            // Extent of the image about its centre: the roots of the dual conic, with axes A = r J(t1), B = r (n·v) J(m).
            vec4 axes = s.radius * vec4(j1, nv * jm);           // (A.x, A.y, B.x, B.y)
            vec2 square = axes.xy * axes.xy + axes.zw * axes.zw;
            vec4 image;
            if (APPROXIMATE || !PERSPECTIVE) {
                vec2 extent = sqrt(square) / w;
                image = vec4(-extent, extent);
            } else {
                vec2 skew = axes.xy * s.slope.x + axes.zw * s.slope.y;
                float k = w * w - dot(s.slope, s.slope);
                vec2 root = sqrt(skew * skew + square * k);
                image = vec4(-skew - root, root - skew) / k;
            }
            vec2 rho = vec2(params.low_pass);
            if (!clipped) {
                s.box = vec4(s.pixel + min(image.xy, -rho), s.pixel + max(image.zw, rho));
            } else {
                s.box = vec4(min(s.box.xy, s.pixel - rho), max(s.box.zw, s.pixel + rho));
            }
        }
        if (near_eye) {
            s.status = TOO_LARGE;
        }
    }
    // What the picture shows of the box; its centre lies inside the clip volume by construction.
    s.box = vec4(max(s.box.xy, -params.middle), min(s.box.zw, params.middle));
    vec2 size = s.box.zw - s.box.xy;
    if (!(size.x > 0.0 && size.y > 0.0)) {
        s.status = OUTSIDE;
    } else if (s.status != TOO_LARGE) {
        // A quarter of a pixel for the rasteriser's grid: point sizes come in steps of at most 1/8, positions of 1/16.
        s.status = max(size.x, size.y) + 0.25 > params.sprite_limit ? TOO_LARGE : DRAWN;
    }
    return s;
}
