#version 300 es
precision highp float;
precision highp int;
precision highp sampler2D;
precision highp sampler2DArray;

uniform vec3 ground;
uniform vec4 place;  // the image's column and row at the canvas's corner, and their steps for each of its pixels

out vec4 colour;

// IEC 61966-2-1.
vec3 encoded(vec3 linear) {
    vec3 c = clamp(linear, 0.0, 1.0);
    return mix(1.055 * pow(max(c, 1e-9), vec3(1.0 / 2.4)) - 0.055, 12.92 * c, vec3(lessThanEqual(c, vec3(0.0031308))));
}

// Colours are multiplied by the share of them that is there.
vec4 shown(vec4 found, float gain) {
    return vec4(found.a > 0.002 ? encoded(gain * found.rgb / found.a) : ground, 1.0);
}
