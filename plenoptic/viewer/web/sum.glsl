// Views, each moved by its own shift, times their weights, which have the sum 1. Filters work on linear light, since
// textures are decoded before; beyond a view, and where it holds nothing, colour and opacity are 0.
uniform sampler2DArray views;
layout(std140) uniform Taps { vec4 taps[256]; };  // shift along columns and rows, number of the view, weight
uniform int count;
uniform vec2 padded;     // columns and rows with a clear pixel on each side

void main() {
    vec2 unit = 1.0 / padded, here = (gl_FragCoord.xy + 1.0) * unit;
    vec4 sum = vec4(0.0);
    for (int k = 0; k < count; k++) {
        vec4 tap = taps[k];
        sum += tap.w * textureLod(views, vec3(here + tap.xy * unit, tap.z), 0.0);
    }
    colour = sum;
}
