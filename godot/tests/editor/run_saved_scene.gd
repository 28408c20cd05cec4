extends SceneTree
## Runs a scene saved by the editor: `--script tests/editor/run_saved_scene.gd -- SCENE`; exit code 0 if it moves as the
## map requires.


func _initialize() -> void:
	var scene: Node = (load(OS.get_cmdline_user_args()[0]) as PackedScene).instantiate()
	root.add_child(scene)
	await process_frame
	var simulation: MindstageSimulation = _simulation_in(scene)
	if simulation == null or not simulation.physics_scene.joints.has("door_hinge"):
		print("the scene has no simulation node or no door hinge")
		quit(2)
		return
	simulation.clock.play(0.0)
	simulation.apply_force("door_handle", MindstageFrames.vector(25.0, 0.0, 0.0), null)
	await simulation.step(3.0)
	var angle: float = simulation.physics_scene.joints["door_hinge"].joint_position()[5]
	var crate_m: float = simulation.rows()[simulation.world_model.bodies["crate"].row * MindstageFrames.ROW + 2]
	print("door %.4f rad, crate %.4f m" % [angle, crate_m])
	quit(0 if absf(angle - PI / 4.0) < 0.01 and absf(crate_m - 0.15) < 0.005 else 1)


func _simulation_in(scene: Node) -> MindstageSimulation:
	for node: Node in scene.find_children("*", "Node3D"):
		if node is MindstageSimulation:
			return node
	return null
