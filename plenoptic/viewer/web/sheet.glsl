// All views side by side as they lie in the pupil, u to the right and v down, with a gap between them.
uniform sampler2DArray views;
uniform vec2 size;
uniform vec2 counts;
uniform float gap;
uniform float gain;

void main() {
    vec2 at = place.xy + gl_FragCoord.xy * place.zw;
    vec2 cell = floor(at / (size + gap));
    vec2 inside = at - cell * (size + gap);
    if (any(lessThan(at, vec2(0.0))) || any(greaterThanEqual(cell, counts)) || any(greaterThanEqual(inside, size))) {
        colour = vec4(0.0);
        return;
    }
    float step = abs(place.z);
    int n = int(clamp(ceil(step / 2.0), 1.0, 8.0));
    vec4 sum = vec4(0.0);
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) {
            vec2 tap = inside + ((vec2(i, j) + 0.5) / float(n) - 0.5) * step;
            sum += textureLod(views, vec3((clamp(tap, vec2(0.5), size - 0.5) + 1.0) / (size + 2.0), cell.x * counts.y + cell.y), 0.0);
        }
    colour = shown(sum / float(n * n), gain);
}
