// How much the views differ in a window around a point, for a disparity each pixel of the output.
uniform sampler2DArray views;
layout(std140) uniform Taps { vec4 taps[256]; };  // offset of a view along columns and rows at disparity 1, number of the view
uniform int count;
uniform vec2 padded;
uniform vec2 point;
uniform vec2 range;       // the first disparity, and the step

const int REACH = 4;

void main() {
    float disparity = range.x + floor(gl_FragCoord.x) * range.y;
    float differences = 0.0, known = 0.0;
    for (int i = -REACH; i <= REACH; i++)
        for (int j = -REACH; j <= REACH; j++) {
            vec3 sum = vec3(0.0), squares = vec3(0.0);
            float n = 0.0;
            for (int k = 0; k < count; k++) {
                vec4 tap = taps[k];
                vec2 at = point + vec2(i, j) - disparity * tap.xy;
                vec4 found = textureLod(views, vec3((at + 1.0) / padded, tap.z), 0.0);
                vec3 c = sqrt(found.rgb);  // so that noise is alike in dark and bright parts
                if (found.a > 0.99) { sum += c; squares += c * c; n += 1.0; }
            }
            if (n > 1.0) {
                vec3 spread = squares / n - sum * sum / (n * n);
                differences += spread.r + spread.g + spread.b;
                known += 1.0;
            }
        }
    colour = vec4(known > 0.0 ? differences / known : 1e3, 0.0, 0.0, 1.0);
}
