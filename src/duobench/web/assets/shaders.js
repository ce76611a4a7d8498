// The programs of the graphics card: light as MuJoCo's renderer has it, and a shadow map.

const BODIES = `#version 300 es
precision highp float;
layout(std140) uniform Bodies { vec4 body_poses[512]; }; // position, then quaternion x y z w
in vec3 position;
in uint body; // number of the body, and 65536 where no shadow falls

vec3 turned(vec3 v) {
  vec4 q = body_poses[2u * (body & 65535u) + 1u];
  return v + 2.0 * cross(q.xyz, cross(q.xyz, v) + q.w * v);
}

vec3 placed(vec3 v) { return turned(v) + body_poses[2u * (body & 65535u)].xyz; }
`;

export const VERTEX = `${BODIES}
in vec4 normal; // the fourth number is the emission
in vec4 colour; // the fourth number is the highlight
uniform mat4 view, projection, light;
uniform vec3 ambient, direction[4], shine[4];
uniform float gloss[4];
uniform int shadowed; // number of the light that casts a shadow, or -1
uniform float texel; // side of one of the shadow map, in metres
out vec3 base, extra, shade;

void main() {
  vec3 at = placed(position), n = normalize(turned(normal.xyz));
  vec3 to_eye = normalize(-(transpose(mat3(view)) * view[3].xyz) - at);
  float glow = (normal.w < 0.0 ? normal.w + 256.0 : normal.w) / 255.0;
  base = colour.rgb * (ambient + glow);
  extra = vec3(0.0); // by the light that casts a shadow
  for (int i = 0; i < 4; i++) {
    float facing = dot(n, -direction[i]);
    if (facing <= 0.0) continue;
    float along = max(0.0, dot(n, normalize(to_eye - direction[i])));
    vec3 share = colour.rgb * facing * shine[i] + gloss[i] * colour.a * pow(along, 64.0);
    if (i == shadowed && body < 65536u) extra = share;
    else base += share;
  }
  // A little before the surface, so that none lies in its own shadow.
  shade = (light * vec4(at + 1.5 * texel * n, 1.0)).xyz * 0.5 + 0.5;
  gl_Position = projection * view * vec4(at, 1.0);
}
`;

export const FRAGMENT = `#version 300 es
precision highp float;
precision highp sampler2DShadow;
in vec3 base, extra, shade;
uniform sampler2DShadow map;
out vec4 result;

float lit() {
  if (any(lessThan(shade, vec3(0.0))) || any(greaterThan(shade, vec3(1.0)))) return 1.0;
  vec2 side = 0.75 / vec2(textureSize(map, 0));
  float sum = 0.0;
  for (int i = 0; i < 4; i++) {
    vec2 there = shade.xy + side * (vec2(i & 1, i >> 1) * 2.0 - 1.0);
    sum += texture(map, vec3(there, shade.z - 0.0005));
  }
  return sum / 4.0;
}

void main() {
  result = vec4(base, 1.0);
  if (extra.r + extra.g + extra.b > 0.002) result.rgb += extra * lit();
}
`;

export const DEPTH_VERTEX = `${BODIES}
uniform mat4 light;
void main() { gl_Position = light * vec4(placed(position), 1.0); }
`;

export const DEPTH_FRAGMENT = `#version 300 es
precision highp float;
void main() {}
`;
