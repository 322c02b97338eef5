/** The compressed arrays of the page: one gzip stream of all of them, one after the other. */

const KINDS = { f4: Float32Array, f8: Float64Array, u4: Uint32Array, u1: Uint8Array };

/** Arrays by name; index: [{name, kind, offset, count}], text: base64 of the stream. */
export async function unpack(index, text) {
  const packed = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  const bytes = await new Response(stream).arrayBuffer();
  return Object.fromEntries(
    index.map(({ name, kind, offset, count }) => [name, new KINDS[kind](bytes, offset, count)]),
  );
}
