"""Files of a crate that need each other in a circle, by what they name (`use` lines and `crate::`, `super::` paths; tests apart).

A file beside what lies in its folder is one thing to read: edges between a module and those within it do not count. Methods that are
called without their type being named are not seen.

    python validation/module_circles.py          # prints each circle with the names that make it; exit code 1 if there is one
"""

import pathlib
import re
import sys

CRATES = pathlib.Path(__file__).resolve().parent.parent / "crates"
USE = re.compile(r"^\s*(pub(?:\([^)]*\))?\s+)?use\s+([^;]+);", re.M)
PATH = re.compile(r"\b(?:crate|super)(?:::\w+)+")


def module(file, source):
    """The path of a module as a tuple of names."""
    parts = list(file.relative_to(source).with_suffix("").parts)
    return tuple(parts[:-1] if parts[-1] in ("mod", "lib", "main") else parts)


def single(prefix, text):
    """The single paths of a `use` with braces."""
    items, depth, item = [], 0, ""
    for letter in text + ",":
        if letter == "," and depth == 0:
            items.append(item.strip())
            item = ""
            continue
        depth += (letter == "{") - (letter == "}")
        item += letter
    for item in filter(None, items):
        start = item.find("{")
        if start >= 0:
            yield from single(prefix + item[:start], item[start + 1 : item.rindex("}")])
        else:
            yield prefix + item


def needed(module_path, text, modules):
    """Modules that a file names, with the names."""
    text = re.split(r"#\[cfg\(test\)\]\s*(?:pub\(\w+\) )?mod tests \{", text)[0]
    text = re.sub(r"//[^\n]*", "", text)
    # What is only passed on makes nobody read further.
    paths = [p for m in USE.finditer(text) if not m.group(1) for p in single("", m.group(2))]
    paths += PATH.findall(re.sub(r"use [^;]+;", "", text))
    found = {}
    for path in paths:
        parts = [p.strip() for p in path.split("::")]
        if parts[0] == "crate":
            base, parts = [], parts[1:]
        elif parts[0] in ("super", "self"):
            base = list(module_path)
            while parts and parts[0] in ("super", "self"):
                base = base[:-1] if parts[0] == "super" else base
                parts = parts[1:]
        elif module_path + (parts[0],) in modules:
            base = list(module_path)
        else:
            continue
        whole = tuple(base + parts)
        there = next((whole[:n] for n in range(len(whole), -1, -1) if whole[:n] in modules), None)
        if there is not None and there != module_path:
            found.setdefault(there, []).append("::".join(whole[len(there) :]))
    return found


def circles(graph):
    """Strongly connected sets of more than one (Tarjan 1972)."""
    number, low, stack, on, found = {}, {}, [], set(), []

    def visit(v):
        number[v] = low[v] = len(number)
        stack.append(v)
        on.add(v)
        for w in graph[v]:
            if w not in number:
                visit(w)
                low[v] = min(low[v], low[w])
            elif w in on:
                low[v] = min(low[v], number[w])
        if low[v] == number[v]:
            component = []
            while not component or component[-1] != v:
                component.append(stack.pop())
                on.discard(component[-1])
            if len(component) > 1:
                found.append(sorted(component))

    for v in graph:
        if v not in number:
            visit(v)
    return found


def related(a, b):
    return a == b[: len(a)] or b == a[: len(b)]


def main():
    sys.setrecursionlimit(10_000)
    count = 0
    for source in sorted(CRATES.glob("*/src")):
        modules = {module(f, source): f for f in sorted(source.rglob("*.rs")) if f.name != "main.rs"}
        names = {m: needed(m, f.read_text(), modules) for m, f in modules.items()}
        graph = {m: {n for n in names[m] if not related(m, n)} for m in modules}
        for circle in circles(graph):
            count += 1
            print(f"{source.parent.name}: {', '.join('/'.join(m) for m in circle)}")
            for m in circle:
                for n in sorted(graph[m] & set(circle)):
                    print(f"    {'/'.join(m)} -> {'/'.join(n)}: {', '.join(sorted(set(names[m][n])))}")
    print(f"{count} circles")
    return count > 0


if __name__ == "__main__":
    sys.exit(main())
