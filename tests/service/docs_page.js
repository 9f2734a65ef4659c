// Runs /docs in Node, in a document that can do what the page's script asks of one, and presses "send" in every box.
// usage: node docs_page.js URL
// Prints JSON: ids of what links may name, links, and boxes with their answers. A script error is an exit status of 1.
"use strict";
const vm = require("node:vm");

class Element {
  constructor(tagName) { Object.assign(this, {tagName, children: [], dataset: {}, acts: []}); }
  set textContent(text) { this.children = [text]; }
  set innerHTML(text) { this.children = [text]; }
  get textContent() { return this.children.map(child => child instanceof Element ? child.textContent : child).join(""); }
  append(...children) { this.children.push(...children); }
  replaceChildren(...children) { this.children = children; }
  replaceWith(other) { Object.assign(this, other); }
  addEventListener(type, act) { this.acts.push([type, act]); }
  fire(type) { for (const [of, act] of this.acts) if (of === type) act(); }
  * [Symbol.iterator]() {
    yield this;
    for (const child of this.children) if (child instanceof Element) yield* child;
  }
}
const pause = () => new Promise(done => setTimeout(done, 5));

async function main(url) {
  const get = async path => (await fetch(new URL(path, url))).text();
  const html = await get("/docs"), body = new Element("body");
  for (const [, id] of html.matchAll(/ id="([^"]+)"/g)) body.append(Object.assign(new Element(""), {id}));
  let latest = null;  // answer
  const asked = fetch;
  Object.assign(globalThis, {
    document: {body, createElement: name => new Element(name), getElementById: id => [...body].find(e => e.id === id)},
    location: {origin: url, hash: ""}, addEventListener: () => {},
    fetch: async (path, options) => latest = await asked(new URL(path, url), options)});
  vm.runInThisContext(await get("/marked.js"));
  for (const [, script] of html.matchAll(/<script>([^]*?)<\/script>/g)) vm.runInThisContext(script, {filename: "docs.html"});
  while (!body.dataset.ready) await pause();

  for (const e of body) if (e.tagName === "details") e.fire("toggle");
  const boxes = [], parents = [...body].flatMap(parent => parent.children.map(child => [child, parent]));
  const parent_of = child => parents.find(([one]) => one === child)[1];
  for (const [button, line] of parents.filter(([e]) => e.tagName === "button" && e.textContent === "send")) {
    const box = parent_of(line), at = box.children.indexOf(line);
    const text = box.children.slice(at).find(e => e.tagName === "textarea"), shown = box.children.slice(at).find(e => e.tagName === "div");
    latest = null;
    button.fire("click");
    while (!shown.children.length) await pause();
    boxes.push({call: line.children[0] + line.children.find(e => e.tagName === "input").value,
                name: box.children[0].textContent, request: text ? JSON.parse(text.value) : null, status: latest?.status,
                missing: Number(latest?.headers.get("Selenograph-Missing-Fraction")), said: shown.textContent});
  }
  const all = [...body];
  process.stdout.write(JSON.stringify({ids: all.map(e => e.id).filter(Boolean), boxes, links: all.map(e => e.href).filter(Boolean)}));
}
process.on("unhandledRejection", error => { console.error(error), process.exit(1); });
main(process.argv[2]);
