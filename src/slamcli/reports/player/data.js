// SPDX-License-Identifier: MIT
// The facts and arrays of the replay: from the server, or out of this very page where they are embedded.

const TYPES = { float32: Float32Array, float64: Float64Array, int32: Int32Array, int16: Int16Array, int8: Int8Array, uint8: Uint8Array };

const embedded = (name) => document.getElementById(`data-${name}`);

async function fetched(address) {
  const answer = await fetch(address);
  if (!answer.ok) throw new Error(`${address}: the server answers ${answer.status}`);
  return answer;
}

async function loadFacts() {
  const here = embedded("replay");
  return here ? JSON.parse(here.textContent) : (await fetched("replay.json")).json();
}

function bytesOf(base64) {
  const text = atob(base64), bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  return bytes;
}

async function loadBuffer(name, href) {
  const here = embedded(name);
  if (!here) return (await fetched(href)).arrayBuffer();
  if (typeof DecompressionStream === "undefined") throw new Error("this browser is too old for a page with embedded data (it has no DecompressionStream)");
  const packed = new Blob([bytesOf(here.textContent)]);
  return new Response(packed.stream().pipeThrough(new DecompressionStream("gzip"))).arrayBuffer();
}

// All arrays by name; they are little-endian, as is every machine that runs a browser today.
async function loadArrays(facts, told) {
  const names = Object.keys(facts.arrays);
  let loaded = 0;
  const pairs = await Promise.all(names.map(async (name) => {
    const entry = facts.arrays[name];
    const buffer = await loadBuffer(name, entry.href);
    told(++loaded, names.length);
    return [name, new TYPES[entry.dtype](buffer)];
  }));
  return Object.fromEntries(pairs);
}

function imageAddress(number) {
  const here = embedded(`image-${number}`);
  return here ? `data:image/jpeg;base64,${here.textContent}` : `image/${number}.jpg`;
}

// Number of elements of an increasing array that are not greater than a value.
function countUpTo(values, value) {
  let low = 0, high = values.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (values[middle] <= value) low = middle + 1; else high = middle;
  }
  return low;
}
