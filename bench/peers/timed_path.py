# SPDX-License-Identifier: GPL-3.0-or-later
"""What programs that compute a load path print: the path, its unknowns, and the processor's seconds."""
import time


def report(load_path):
    """load_path() says ([(t, force), ...], unknowns)."""
    start = time.process_time()
    result, unknowns = load_path()
    seconds = time.process_time() - start
    print("t,force")
    for t, force in result:
        print(f"{t:g},{force:.10g}")
    print(f"# unknowns {unknowns}\n# seconds {seconds:.3f}")
