// A picture through the window: cubic between pixels when much enlarged, single pixels when these are large, means
// when reduced. Pixel by pixel it is the picture itself.
uniform sampler2D picture;
uniform vec2 size;
uniform float gain;

// R. G. Keys, IEEE Trans. ASSP 29 (1981), doi:10.1109/TASSP.1981.1163711.
vec4 shares(float t) {
    return vec4(((2.0 - t) * t - 1.0) * t, (3.0 * t - 5.0) * t * t + 2.0, ((4.0 - 3.0 * t) * t + 1.0) * t,
                (t - 1.0) * t * t) * 0.5;
}

vec4 cubic(vec2 at) {
    vec2 base = floor(at - 0.5), t = at - 0.5 - base;
    vec4 across = shares(t.x), down = shares(t.y), sum = vec4(0.0), low = vec4(1e9), high = vec4(-1e9);
    for (int j = 0; j < 4; j++)
        for (int i = 0; i < 4; i++) {
            vec4 tap = texelFetch(picture, ivec2(clamp(base + vec2(i - 1, j - 1), vec2(0.0), size - 1.0)), 0);
            sum += across[i] * down[j] * tap;
            if (i == 1 || i == 2) if (j == 1 || j == 2) { low = min(low, tap); high = max(high, tap); }
        }
    // No brighter and no darker than the pixels around: edges get no rims.
    return clamp(sum, low, high);
}

void main() {
    vec2 at = place.xy + gl_FragCoord.xy * place.zw;
    if (any(lessThan(at, vec2(0.0))) || any(greaterThanEqual(at, size))) {
        colour = vec4(0.0);
        return;
    }
    float step = abs(place.z);
    if (step < 1.0 / 32.0) {
        colour = shown(texelFetch(picture, ivec2(at), 0), gain);
        return;
    }
    if (step < 0.5) {
        colour = shown(cubic(at), gain);
        return;
    }
    int n = int(clamp(ceil(step), 1.0, 8.0));
    vec4 sum = vec4(0.0);
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++)
            sum += textureLod(picture, (at + ((vec2(i, j) + 0.5) / float(n) - 0.5) * step) / size, 0.0);
    colour = shown(sum / float(n * n), gain);
}
