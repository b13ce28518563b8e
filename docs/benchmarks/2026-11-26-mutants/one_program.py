#!/usr/bin/env python3
"""All mutants of a crate in one test program, chosen by MUTANT in its environment: one build in place of hundreds.

    git worktree add --detach ../mutants && cd ../mutants
    cargo mutants --list --json --no-config --file 'crates/flight/src/gate.rs' > list.json
    one_program.py tello-flight crates/flight list.json gate > outcomes.csv     # the last words filter tests

Prints the outcome of every mutant. Changes the sources of the crate in the present folder, and leaves them changed. A mutant survives if all tests that the
filter lets through pass, and then all others of the library.
"""

import collections
import csv
import json
import os
import re
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

package, crate, listed = sys.argv[1:4]
filters = sys.argv[4:]
mutants = json.load(open(listed))
SWITCH = """
#![allow(warnings, missing_docs, clippy::all, arithmetic_overflow, unconditional_panic)]
/// The chosen mutant.
pub mod mutation {
    static CHOSEN: std::sync::OnceLock<i64> = std::sync::OnceLock::new();
    pub fn which() -> i64 {
        *CHOSEN.get_or_init(|| std::env::var("MUTANT").ok().and_then(|it| it.parse().ok()).unwrap_or(-1))
    }
}
"""


def write(left_out):
    """Gives every function an arm for each of its mutants."""
    subprocess.run(["git", "checkout", "-q", f"{crate}/src"], check=True)
    functions = collections.defaultdict(list)
    for number, mutant in enumerate(mutants):
        if number not in left_out and mutant.get("function"):
            span = mutant["function"]["span"]
            place = tuple((span[end]["line"], span[end]["column"]) for end in ("start", "end"))
            functions[mutant["file"], place].append((number, mutant))
    # From the end of a file on, so that the places before it stay.
    for (file, (start, end)), of_function in sorted(functions.items(), reverse=True):
        text = open(file).read()
        begins = [0]
        for line in text.split("\n"):
            begins.append(begins[-1] + len(line) + 1)
        at = lambda line, column: begins[line - 1] + column - 1
        first, last = at(*start), at(*end)
        depth, body = 0, last
        while True:
            body -= 1
            depth += {"}": 1, "{": -1}.get(text[body], 0)
            if depth == 0:
                break
        arms = []
        for number, mutant in of_function:
            a, b = (at(mutant["span"][end]["line"], mutant["span"][end]["column"]) for end in ("start", "end"))
            arms.append(f"/*MUTANT{number}*/ {number} => {text[body:a]}{mutant['replacement']}{text[b:last]}\n")
        head = text[first:body].replace("const fn", "fn")
        changed = f"{head}{{ match crate::mutation::which() {{\n{''.join(arms)}/*MUTANT-1*/ _ => {text[body:last]}\n}} }}"
        open(file, "w").write(text[:first] + changed + text[last:])
    root = f"{crate}/src/lib.rs"
    lines = open(root).read().split("\n")
    docs = next(k for k, line in enumerate(lines) if not line.startswith("//!"))
    open(root, "w").write("\n".join(lines[:docs]) + SWITCH + "\n".join(lines[docs:]))


def cargo(*words):
    """The messages of the compiler."""
    done = subprocess.run(["cargo", *words, "-p", package, "--lib", "--message-format=json"], capture_output=True, text=True)
    return [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]


# The arms of a function that returns `impl Trait` would have several types.
is_opaque = lambda it: "impl " in ((it.get("function") or {}).get("return_type") or "")
left_out = {number for number, it in enumerate(mutants) if is_opaque(it)}
while True:
    write(left_out)
    found = set()
    for message in cargo("check"):
        if message["reason"] != "compiler-message" or message["message"]["level"] != "error":
            continue
        for span in message["message"]["spans"]:
            # In a macro of the standard library: where it is called.
            while not os.path.exists(span["file_name"]) and span.get("expansion"):
                span = {**span["expansion"]["span"], "is_primary": span["is_primary"]}
            before = "\n".join(open(span["file_name"]).read().split("\n")[: span["line_start"]])
            numbers = re.findall(r"/\*MUTANT(-?\d+)\*/", before)
            found |= {int(number) for number in numbers[-1:] if number != "-1"} if span["is_primary"] else set()
    if not found:
        break
    left_out |= found
program = next(it["executable"] for it in cargo("test", "--no-run") if it.get("executable"))


def survives(number):
    for words in (filters, []):
        environment = dict(os.environ, MUTANT=str(number))
        try:
            run = subprocess.run([program, *words], cwd=crate, env=environment, capture_output=True, timeout=600)
        except subprocess.TimeoutExpired:
            return False
        if run.returncode != 0:
            return False
    return True


assert survives(-1), "the tests fail without a mutant"
chosen = [k for k, it in enumerate(mutants) if k not in left_out and it.get("function")]
with ThreadPoolExecutor(2) as pool:
    left = [number for number, lives in zip(chosen, pool.map(survives, chosen)) if lives]
outcomes = {number: "survives" if number in left else "caught" for number in chosen}
rows = csv.writer(sys.stdout, lineterminator="\n")
rows.writerow(["outcome", "mutant"])
for number, it in enumerate(mutants):
    not_run = "of a function that returns impl Trait" if is_opaque(it) else "does not compile"
    rows.writerow([outcomes.get(number, not_run if it.get("function") else "of a constant"), it["name"]])
print(f"{len(mutants)} mutants, {len(chosen)} run, {len(left)} survive", file=sys.stderr)
