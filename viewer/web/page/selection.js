// Which taxels are chosen, by their numbers among all of the scene, and what a click chooses.

// The part that a taxel is on, by its number among all; undefined where there is none.
export function partOf(header, number) {
  return header.parts.find(({ taxels: [first, count] }) => number >= first && number < first + count);
}

export class Chosen {
  constructor({ header, arrays }) {
    this.header = header;
    this.arrays = arrays;
    this.numbers = new Set();
    this.version = 0;
  }

  get count() {
    return this.numbers.size;
  }

  replace(numbers) {
    this.numbers = new Set(numbers);
    this.version += 1;
  }

  add(numbers) {
    this.replace([...this.numbers, ...numbers]);
  }

  // Add taxels; where all of them are chosen already, let them go.
  toggle(numbers) {
    const all = numbers.every((number) => this.numbers.has(number));
    if (!all) this.add(numbers);
    else this.replace([...this.numbers].filter((number) => !numbers.includes(number)));
  }

  // Chosen numbers of each part that has any, in rising order.
  byPart() {
    const found = new Map();
    for (const number of [...this.numbers].sort((a, b) => a - b)) {
      const part = partOf(this.header, number);
      if (!found.has(part)) found.set(part, []);
      found.get(part).push(number);
    }
    return found;
  }

  // What one click chooses: the taxel, its module or its patch; one of no patch is alone.
  reached(number, reach) {
    const list = { module: this.arrays["taxel.modules"], patch: this.arrays["taxel.patches"] }[reach];
    if (!list || (reach === "patch" && list[number] < 0)) return [number];
    const [first, count] = partOf(this.header, number).taxels;
    return Array.from({ length: count }, (_, k) => first + k).filter((k) => list[k] === list[number]);
  }

  // Colours of the traces of so many taxels; one ink where there are too many to tell apart.
  tints(count) {
    const { traces, colours } = this.header;
    return Array.from({ length: count }, (_, k) => (count > traces.length ? colours.ink : traces[k]));
  }
}
