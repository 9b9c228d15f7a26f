// A row of the views from left to right, one below the other: what is in focus stands upright.
uniform sampler2DArray views;
layout(std140) uniform Taps { vec4 taps[256]; };  // shift along columns and rows, number of the view
uniform float rows;   // of the slice, on the canvas
uniform float row;
uniform int count;
uniform vec2 size;
uniform float gain;

void main() {
    float column = place.x + gl_FragCoord.x * place.z;
    int which = clamp(int((1.0 - gl_FragCoord.y / rows) * float(count)), 0, count - 1);
    vec4 tap = taps[which];
    vec4 found = textureLod(views, vec3((vec2(column, row + 0.5) + 1.0 + tap.xy) / (size + 2.0), tap.z), 0.0);
    colour = column < 0.0 || column >= size.x ? vec4(0.0) : shown(found, gain);
}
