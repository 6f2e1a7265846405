// SPDX-License-Identifier: GPL-3.0-or-later
// Blocks in three layers, each turned against those below.
SetFactory("OpenCASCADE");
n = 0;
For layer In {0:2}
  For i In {0:1}
    For j In {0:1}
      n += 1;
      Box(n) = {0.36 * i, 0.36 * j, 0.33 * layer + 0.02, 0.3, 0.3, 0.3};
      Rotate{ {0, 0, 1}, {0.33, 0.33, 0}, 0.35 * layer } { Volume{n}; }
      Physical Volume(Sprintf("block %g", n)) = {n};
    EndFor
  EndFor
EndFor
