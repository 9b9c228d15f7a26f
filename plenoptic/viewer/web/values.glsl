// One number a pixel, as a colour.
uniform sampler2D plane;
uniform sampler2D table;
uniform vec2 size;
uniform vec2 range;

void main() {
    vec2 at = place.xy + gl_FragCoord.xy * place.zw;
    if (any(lessThan(at, vec2(0.0))) || any(greaterThanEqual(at, size))) {
        colour = vec4(0.0);
        return;
    }
    float value = texelFetch(plane, ivec2(at), 0).r;
    float share = clamp((value - range.x) / (range.y - range.x), 0.0, 1.0);
    colour = value > 1e38 ? vec4(ground, 1.0) : vec4(texelFetch(table, ivec2(share * 255.0 + 0.5, 0), 0).rgb, 1.0);
}
