import datagen
import surrogate

datagen.run("beam2d", "data/nodal", samples=200)
datagen.structure("data/nodal", "data/structured")
dataset = surrogate.read_dataset("data/structured")
model = surrogate.train("mechanics-fast", dataset, "run")
print(surrogate.evaluate("run", dataset))
solution = model.solve("4,1:0,-1.5", certify="full", tolerance=1e-3)
print(solution)
solution.plot().savefig("solution.png")
