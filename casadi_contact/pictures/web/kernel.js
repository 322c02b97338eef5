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
    this.call = (what, ...offsets) => exports[`${name}_${what}`](...offsets);
    this.memory = memory;
    this.sizes = { loads, patches };
    this.pose = memory.place(6);
    this.values = memory.place(Math.max(loads, patches));
    this.slopes = memory.place(6 * Math.max(loads, patches));
  }

  set(pose) {
    this.memory.at(this.pose, 6).set(pose);
  }

  result(count) {
    return {
      values: this.memory.at(this.values, count).slice(),
      slopes: this.memory.at(this.slopes, 6 * count).slice(),
    };
  }

  /** Loads and their derivatives by the pose, row after row. */
  jacobian(pose) {
    this.set(pose);
    this.call("jacobian", this.pose, this.values, this.slopes);
    return this.result(this.sizes.loads);
  }

  loads(pose) {
    this.set(pose);
    this.call("loads", this.pose, this.values);
    return this.memory.at(this.values, this.sizes.loads).slice();
  }

  /** Signed root load of each patch and its derivatives. */
  roots(pose) {
    this.set(pose);
    this.call("roots", this.pose, this.values, this.slopes);
    return this.result(this.sizes.patches);
  }

  /** Validity and the expected error of each load; NaN for a model without. */
  confidence(pose) {
    this.set(pose);
    this.call("confidence", this.pose, this.slopes, this.values);
    return {
      validity: this.memory.at(this.slopes, 1)[0],
      errors: this.memory.at(this.values, this.sizes.loads).slice(),
    };
  }
}

/** The contact model, which has pressures as well; surfaces: of each patch, with places. */
class ContactModel extends Model {
  constructor(exports, memory, loads, surfaces) {
    super(exports, memory, "contact", loads, surfaces.length);
    this.exports = exports;
    this.surfaces = surfaces.map(({ places, points }) => {
      const [offset, count] = [memory.place(places.length), points.length / 3];
      return { count, places: offset, given: places, pressures: memory.place(count) };
    });
    this.outputs = memory.place(PRESSURES * surfaces.length);
    for (const surface of this.surfaces) memory.at(surface.places, surface.given.length).set(surface.given);
  }

  /** Pressure [MPa] at the points of a patch. */
  pressures(pose, patch) {
    const { places, count, pressures } = this.surfaces[patch];
    this.set(pose);
    this.exports.foundation_pressures(this.pose, patch, count, places, pressures);
    return this.memory.at(pressures, count).slice();
  }

  /** Area [mm²], force [N], peak pressure [MPa] and centre of pressure [mm] (null out of contact) of each patch. */
  contact(pose) {
    this.set(pose);
    this.call("pressures", this.pose, this.outputs);
    return this.surfaces.map((_, patch) => {
      const [area, mean, peak, ...centre] = this.memory.at(this.outputs + PRESSURES * DOUBLE * patch, 6);
      return { area, force: area * mean, peak, centre: mean > 0 ? centre : null };
    });
  }
}

/** The models of a page's module; surrogate is null where there is none. */
export async function loadModels(bytes, { loads, surrogateLoads, surfaces }) {
  const { instance } = await WebAssembly.instantiate(bytes, {});
  const exports = instance.exports;
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
  return Object.fromEntries(
    index.map(({ name, kind, offset, count }) => [name, new KINDS[kind](bytes, offset, count)]),
  );
}
