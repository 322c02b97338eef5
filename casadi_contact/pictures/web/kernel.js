/** The page's arrays, and the contact models in WebAssembly. Poses are (tx, ty, tz [mm], rx, ry, rz [rad]); loads in N and N·mm. */

const DOUBLE = 8;
const PRESSURES = 7; // of a patch: area, mean, peak, centre of pressure (3), penetration

/** Memory of a module from its heap's base on, handed out once. */
class Memory {
  constructor(exports) {
    this.memory = exports.memory;
    this.next = Math.ceil(exports.__heap_base.value / 16) * 16;
  }

  /** Offset of so many doubles. */
  place(count) {
    const offset = this.next;
    this.next += Math.ceil((count * DOUBLE) / 16) * 16;
    const missing = this.next - this.memory.buffer.byteLength;
    if (missing > 0) this.memory.grow(Math.ceil(missing / 65536));
    return offset;
  }

  /** The doubles at an offset, as they are now. */
  at(offset, count) {
    return new Float64Array(this.memory.buffer, offset, count);
  }
}

/** One exported model: NAME_loads and its like (see the header of an exported kernel). */
class Model {
  constructor(exports, memory, name, loads, patches) {
    Object.assign(this, { exports, memory, name, count: loads, patches });
    [this.pose, this.values, this.slopes] = [6, Math.max(loads, patches), 6 * Math.max(loads, patches)].map((n) => memory.place(n));
  }

  call(what, pose, ...offsets) {
    this.memory.at(this.pose, 6).set(pose);
    this.exports[what](this.pose, ...offsets);
  }

  /** Values and their derivatives by the pose, row after row: of the loads ("jacobian"), or of each patch's signed root load ("roots"). */
  both(what, pose) {
    const count = what === "roots" ? this.patches : this.count;
    this.call(`${this.name}_${what}`, pose, this.values, this.slopes);
    return { values: this.memory.at(this.values, count).slice(), slopes: this.memory.at(this.slopes, 6 * count).slice() };
  }

  loads(pose) {
    this.call(`${this.name}_loads`, pose, this.values);
    return this.memory.at(this.values, this.count).slice();
  }

  /** Validity and the expected error of each load; NaN for a model without. */
  confidence(pose) {
    this.call(`${this.name}_confidence`, pose, this.slopes, this.values);
    return { validity: this.memory.at(this.slopes, 1)[0], errors: this.memory.at(this.values, this.count).slice() };
  }
}

/** The contact model, which has pressures as well; surfaces: of each patch, with places. */
class ContactModel extends Model {
  constructor(exports, memory, loads, surfaces) {
    super(exports, memory, "contact", loads, surfaces.length);
    this.surfaces = surfaces.map(({ places, points }) => {
      const [offset, count] = [memory.place(places.length), points.length / 3];
      memory.at(offset, places.length).set(places);
      return { count, places: offset, pressures: memory.place(count) };
    });
    this.outputs = memory.place(PRESSURES * surfaces.length);
  }

  /** Pressure [MPa] at the points of a patch. */
  pressures(pose, patch) {
    const { places, count, pressures } = this.surfaces[patch];
    this.call("foundation_pressures", pose, patch, count, places, pressures);
    return this.memory.at(pressures, count).slice();
  }

  /** Area [mm²], force [N], peak pressure [MPa] and centre of pressure [mm] (null out of contact) of each patch. */
  contact(pose) {
    this.call("contact_pressures", pose, this.outputs);
    return this.surfaces.map((_, patch) => {
      const [area, mean, peak, ...centre] = this.memory.at(this.outputs + PRESSURES * DOUBLE * patch, 6);
      return { area, force: area * mean, peak, centre: mean > 0 ? centre : null };
    });
  }
}

/** The models of a page's module; surrogate is null where there is none. */
export async function loadModels(bytes, loads, surrogateLoads, surfaces) {
  const { exports } = (await WebAssembly.instantiate(bytes, {})).instance;
  exports._initialize?.();
  const memory = new Memory(exports);
  return {
    contact: new ContactModel(exports, memory, loads, surfaces),
    surrogate: surrogateLoads ? new Model(exports, memory, "surrogate", surrogateLoads, surfaces.length) : null,
  };
}

const KINDS = { f4: Float32Array, f8: Float64Array, u4: Uint32Array, u1: Uint8Array };

/** Arrays by name, of one gzip stream of all, one after the other; index: [{name, kind, offset, count}], text: base64 of the stream. */
export async function unpack(index, text) {
  const packed = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  const bytes = await new Response(stream).arrayBuffer();
  return Object.fromEntries(index.map(({ name, kind, offset, count }) => [name, new KINDS[kind](bytes, offset, count)]));
}
