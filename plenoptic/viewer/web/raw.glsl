// The raw image through the window: every pixel of the canvas is the mean over what it covers, so that single pixels
// have clean edges and nothing flickers while it is zoomed.
uniform sampler2D picture;  // linear, 1 in the last number where there is a value
uniform vec2 size;
uniform float gain;

void main() {
    vec2 at = place.xy + gl_FragCoord.xy * place.zw;
    if (any(lessThan(at, vec2(0.0))) || any(greaterThanEqual(at, size))) {
        colour = vec4(0.0);
        return;
    }
    vec2 reach = 0.5 * abs(place.zw);
    vec2 low = max(at - reach, vec2(0.0)), high = min(at + reach, size);
    ivec2 first = ivec2(low), last = min(ivec2(ceil(high)), ivec2(size)) - 1;
    ivec2 stride = max((last - first + 16) / 16, ivec2(1));
    vec4 sum = vec4(0.0);
    float all = 0.0;
    for (int y = first.y; y <= last.y; y += stride.y)
        for (int x = first.x; x <= last.x; x += stride.x) {
            vec2 part = min(high, vec2(x, y) + 1.0) - max(low, vec2(x, y));
            sum += part.x * part.y * texelFetch(picture, ivec2(x, y), 0);
            all += part.x * part.y;
        }
    colour = shown(sum / all, gain);
}
