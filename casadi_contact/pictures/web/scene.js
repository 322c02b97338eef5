/** The two bodies in 3-D: the fixed one coloured by pressure, the moving one as glass. Drawn by twgl. */

import { BONE, sharpened } from "./canvas.js";
import { rotation } from "./linear.js";

const vertexShader = (colours) => `#version 300 es
uniform mat4 world, view_projection; uniform vec3 bare, colours[${colours}]; uniform float largest;
in vec3 position, normal; in float pressure; out vec3 n, c, p;
void main() {
  vec4 at = world * vec4(position, 1.0);
  n = mat3(world) * normal; p = at.xyz;
  c = pressure > 0.0 ? colours[int(${colours - 1}.0 * min(pressure / largest, 1.0) + 0.5)] : bare;
  gl_Position = view_projection * at;
}`;
const FRAGMENT = `#version 300 es
precision highp float;
uniform vec3 eye, light; uniform float opacity;
in vec3 n, c, p; out vec4 pixel;
void main() {
  vec3 m = normalize(n), to_eye = normalize(eye - p);
  if (dot(m, to_eye) < 0.0) m = -m;
  float diffuse = max(dot(m, light), 0.0), rim = pow(1.0 - abs(dot(m, to_eye)), 3.0);
  float gloss = pow(max(dot(reflect(-light, m), to_eye), 0.0), 24.0);
  vec3 lit = c * (0.48 + 0.56 * diffuse) + 0.10 * gloss;
  pixel = vec4(lit, mix(opacity, min(1.0, opacity + 0.45), opacity < 1.0 ? rim : 0.0));
}`;
const STEEL = [0.62, 0.68, 0.74];
const GLASS = 0.3;

export class Bodies {
  constructor(gl, content, fixed, behind, moving) {
    this.gl = gl;
    this.program = twgl.createProgramInfo(gl, [vertexShader(content.colours.length), FRAGMENT]);
    this.colours = content.colours.flat();
    this.fixed = fixed.map((surface) => this.buffers(surface, new Float32Array(surface.points.length / 3)));
    [this.behind, this.moving] = [behind, moving].map((body) => this.buffers(body));
    Object.assign(this, { target: content.view.target, distance: content.view.distance });
    const [x, y, z] = content.view.eye;
    [this.yaw, this.pitch] = [Math.atan2(x, z), Math.asin(Math.min(Math.max(y, -0.99), 0.99))];
    this.turnedBy(gl.canvas);
  }

  /** pressures: of a surface that is coloured by them. */
  buffers({ points, normals, corners }, pressures) {
    const values = pressures ? { data: pressures, drawType: this.gl.DYNAMIC_DRAW } : { value: [0] };
    const pressure = { numComponents: 1, ...values };
    return twgl.createBufferInfoFromArrays(this.gl, { position: points, normal: normals, pressure, indices: corners });
  }

  /** Drag turns, the wheel comes closer. */
  turnedBy(canvas) {
    canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
    canvas.addEventListener("pointermove", (event) => {
      if (!event.buttons) return;
      this.yaw -= 0.01 * event.movementX;
      this.pitch = Math.min(Math.max(this.pitch + 0.01 * event.movementY, -1.5), 1.5);
      this.draw();
    });
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.distance *= Math.exp(0.001 * event.deltaY);
      this.draw();
    }, { passive: false });
  }

  /** Pressures of each patch; largest: where the colours end. */
  show(pose, pressures, largest) {
    pressures.forEach((values, patch) => {
      twgl.setAttribInfoBufferFromArray(this.gl, this.fixed[patch].attribs.pressure, Float32Array.from(values));
    });
    const R = rotation(pose);
    const column = (k) => [R[0][k], R[1][k], R[2][k], 0];
    this.world = [...column(0), ...column(1), ...column(2), ...pose.slice(0, 3), 1];
    this.largest = largest;
    this.draw();
  }

  draw() {
    const { gl } = this;
    sharpened(gl.canvas);
    const { width, height } = gl.canvas;
    gl.viewport(0, 0, width, height);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.enable(gl.CULL_FACE); // what faces away lies behind what does not
    gl.useProgram(this.program.program);
    const [c, s] = [Math.cos(this.pitch), Math.sin(this.pitch)];
    const way = [c * Math.sin(this.yaw), s, c * Math.cos(this.yaw)];
    const eye = this.target.map((part, k) => part + this.distance * way[k]);
    const camera = twgl.m4.lookAt(eye, this.target, [0, 1, 0]);
    const lens = twgl.m4.perspective(0.5, width / height, 0.05 * this.distance, 4 * this.distance);
    const right = camera.slice(0, 3);
    const light = twgl.v3.normalize([0, 1, 2].map((k) => way[k] - 0.5 * right[k] + (k === 1 ? 0.5 : 0)));
    const view_projection = twgl.m4.multiply(lens, twgl.m4.inverse(camera));
    twgl.setUniforms(this.program, { colours: this.colours, largest: this.largest, view_projection, eye, light });
    for (const body of [...this.fixed, this.behind]) this.body(body, { world: twgl.m4.identity(), bare: BONE, opacity: 1 });
    gl.enable(gl.BLEND);
    gl.blendFuncSeparate(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA, gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.depthMask(false);
    for (const side of [gl.FRONT, gl.BACK]) {
      gl.cullFace(side);
      this.body(this.moving, { world: this.world, bare: STEEL, opacity: GLASS });
    }
    gl.depthMask(true);
    gl.disable(gl.BLEND);
    gl.flush(); // it draws while the page goes on
  }

  body(buffers, uniforms) {
    twgl.setBuffersAndAttributes(this.gl, this.program, buffers);
    twgl.setUniforms(this.program, uniforms);
    twgl.drawBufferInfo(this.gl, buffers);
  }
}
