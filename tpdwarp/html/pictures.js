"use strict";
// Pictures of log codes (see pictures.py) that are re-exposed, and heat maps that are coloured, on a canvas.
const KNEE = 64;
const HEAT = [[0, 0, 4], [66, 15, 117], [147, 38, 103], [221, 81, 58], [252, 165, 10], [252, 255, 164]];

function loadCodes(source) {
  return new Promise((resolve, reject) => {
    const image = new Image();
    image.onload = () => {
      const sheet = document.createElement("canvas");
      sheet.width = image.naturalWidth;
      sheet.height = image.naturalHeight;
      const pen = sheet.getContext("2d", { willReadFrequently: true });
      pen.drawImage(image, 0, 0);
      resolve(pen.getImageData(0, 0, sheet.width, sheet.height));
    };
    image.onerror = () => reject(new Error("a picture of this report cannot be decoded"));
    image.src = source;
  });
}

function linearOf(code, largest) {
  return Math.expm1((code / 255) * Math.log1p(KNEE * largest)) / KNEE;
}

function exposureTable(largest, stops) {
  const table = new Uint8ClampedArray(256);
  for (let code = 0; code < 256; code += 1) {
    const value = Math.min(1, linearOf(code, largest) * 2 ** stops);
    const encoded = value <= 0.0031308 ? 12.92 * value : 1.055 * value ** (1 / 2.4) - 0.055;
    table[code] = Math.round(255 * encoded);
  }
  return table;
}

function exposed(codes, largest, stops) {
  const table = exposureTable(largest, stops);
  const out = new ImageData(codes.width, codes.height);
  for (let i = 0; i < codes.data.length; i += 4) {
    for (let c = 0; c < 3; c += 1) out.data[i + c] = table[codes.data[i + c]];
    out.data[i + 3] = 255;
  }
  return out;
}

function heated(codes) {
  const out = new ImageData(codes.width, codes.height);
  for (let i = 0; i < codes.data.length; i += 4) {
    const place = (codes.data[i] / 255) * (HEAT.length - 1);
    const low = Math.min(Math.floor(place), HEAT.length - 2);
    for (let c = 0; c < 3; c += 1) out.data[i + c] = HEAT[low][c] + (place - low) * (HEAT[low + 1][c] - HEAT[low][c]);
    out.data[i + 3] = 255;
  }
  return out;
}

function paint(canvas, pixels, words) {
  canvas.width = pixels.width;
  canvas.height = pixels.height;
  canvas.getContext("2d").putImageData(pixels, 0, 0);
  canvas.setAttribute("role", "img");
  canvas.setAttribute("aria-label", words);
}
