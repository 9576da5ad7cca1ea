"""The field's architecture in PyTorch, on the processor or (with cuda) on a graphics processor, as a yardstick:
16 levels x 2 features in tables of 2^19 (hashed, trilinear), a density MLP 1 x 64 and a colour MLP 2 x 64; forward,
backward and Adam over batches of the same size and kind as bench_work's.
Prints samples/s by the clock and by processor time; 77 is the exit code without torch, or without a device of CUDA.
usage: peer_torch.py [STEPS [cuda|processor]]"""
import sys
import time

try:
    import torch
except ImportError:
    print("skipped: python3-torch is not installed", file=sys.stderr)
    sys.exit(77)

LEVELS, FEATURES, SIZE, BASE, FINEST, SAMPLES, RAY = 16, 2, 1 << 19, 16, 4096, 683 * 48, 32


class Grid(torch.nn.Module):
    def __init__(self):
        super().__init__()
        growth = (FINEST / BASE) ** (1 / (LEVELS - 1))
        self.resolution = [int(BASE * growth**level + 1e-6) for level in range(LEVELS)]
        self.entries = [min((r + 2) ** 3, SIZE) for r in self.resolution]
        self.table = torch.nn.ParameterList(
            torch.nn.Parameter((torch.rand(n, FEATURES) * 2 - 1) * 1e-4) for n in self.entries)

    def forward(self, x):
        found = []
        for resolution, entries, table in zip(self.resolution, self.entries, self.table):
            scaled = x * resolution + 0.5
            cell = scaled.floor()
            f = scaled - cell
            c = cell.long()
            total = 0
            for corner in range(8):
                o = [(corner >> a) & 1 for a in range(3)]
                v = [c[:, a] + o[a] for a in range(3)]
                if entries == SIZE:
                    index = (v[0] ^ (v[1] * 2654435761) ^ (v[2] * 805459861)) & (SIZE - 1)
                else:
                    side = resolution + 2
                    index = v[0] + side * (v[1] + side * v[2])
                w = 1
                for a in range(3):
                    w = w * (f[:, a] if o[a] else 1 - f[:, a])
                total = total + w[:, None] * table[index]
            found.append(total)
        return torch.cat(found, 1)


class Field(torch.nn.Module):
    def __init__(self):
        super().__init__()
        self.grid = Grid()
        layer = lambda n, m: torch.nn.Linear(n, m, bias=False)
        relu = torch.nn.ReLU
        self.density = torch.nn.Sequential(layer(LEVELS * FEATURES, 64), relu(), layer(64, 16))
        self.colour = torch.nn.Sequential(layer(16, 64), relu(), layer(64, 64), relu(), layer(64, 4))

    def forward(self, x):
        return self.colour(self.density(self.grid(x)))


def main():
    steps = int(sys.argv[1]) if len(sys.argv) > 1 else 5
    cuda = sys.argv[2:] == ["cuda"]
    if cuda and not torch.cuda.is_available():
        print("skipped: torch finds no device of CUDA", file=sys.stderr)
        sys.exit(77)
    torch.manual_seed(1)
    torch.set_default_device("cuda" if cuda else "cpu")
    field = Field()
    adam = torch.optim.Adam(field.parameters(), lr=1e-3, betas=(0.9, 0.99), eps=1e-15)
    rays = SAMPLES // RAY + 1
    t = (1 + 1 / 256) ** torch.arange(RAY)
    x = (torch.rand(rays, 1, 3) - 0.5) + t[None, :, None] * (torch.rand(rays, 1, 3) - 0.5)
    x = (x.reshape(-1, 3)[:SAMPLES] * 0.25 + 0.5).clamp(0, 1)
    took, ran = [], []
    for step in range(steps + 1):
        start, busy = time.perf_counter(), time.process_time()
        adam.zero_grad(set_to_none=True)
        ((field(x) - 0.5) ** 2).mean().backward()
        adam.step()
        if cuda:
            torch.cuda.synchronize()
        if step:
            took.append(time.perf_counter() - start)
            ran.append((time.process_time() - busy) / torch.get_num_threads())
    print(*(f"{SAMPLES / sorted(s)[len(s) // 2]:.0f}" for s in (took, ran)))


main()
