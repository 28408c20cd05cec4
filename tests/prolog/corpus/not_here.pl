% Rules that need what KnowRob has and Mindstage has not: each is loaded, and its goal says so when it is called.

needs(perception, create_object_perception('Cup', _, [], _)).
needs(perception, create_perception_instance([], _)).
needs(perception, set_perception_pose(_, _)).
needs(perception, set_object_perception(_, _)).
needs(changes, object_assert_color(fridge, red)).
needs(changes, object_assert_dimensions(fridge, 1, 1, 1)).
needs(changes, create_joint_information(_, _, _, _, _, _, _, _, _)).
needs(changes, update_joint_information(_, _, _, _, _, _, _)).
needs(changes, delete_object_information(fridge)).
needs(maps, map_read_all(_, _)).
needs(maps, object_information(fridge, _, _, _, _, _, _, _)).
needs(maps, comp_center(fridge, _)).
needs(maps, objectAtPoint2D(0, _)).
needs(episodes, object_trajectory(fridge, _, 1.0, _)).
needs(episodes, assert_temporal_part(_, _, _, _)).
needs(episodes, event_before(_, _)).
needs(episodes, event_after(_, _)).
needs(episodes, task_goal(_, _)).
needs(episodes, mem_episode_start(_)).
needs(episodes, mem_episode_stop(_)).
needs(mongo, mng_latest_designator(_, _, _, _)).
needs(mongo, mng_lookup_transform(_, _, _, _)).
needs(mongo, mng_designator(_, _)).
needs(mongo, mng_query(tf, _)).
needs(ros, ros_init).
needs(ros, json_prolog_init).
needs(ros, tf_listener_start).
needs(ros, tf_lookup_transform(map, base_link, _)).
needs(ros, transform_pose_prolog(base_link, _, _, _)).
needs(ros, urdf_load(robot, 'robot.urdf')).
needs(ros, urdf_load(robot, 'robot.urdf', [])).
needs(java, jpl_load_library).
needs(java, visualisation_canvas(_)).
needs(java, camera_pose([0, 0, 5], [1, 0, 0, 0])).
needs(visualization, visualisation_canvas).
needs(visualization, clear_canvas).
needs(visualization, show_marker(cup, _)).
needs(visualization, show_marker(cup, _, [])).
needs(visualization, show_markers([cup])).
needs(visualization, data_vis(chart(speed), [])).
needs(visualization, designator_publish(_)).
needs(visualization, designator_publish(_, _)).
needs(visualization, designator_publish_image(_)).
needs(visualization, add_object(cup)).
needs(visualization, add_object(cup, 0)).
needs(visualization, add_objects([cup])).
needs(visualization, add_object_with_children(kitchen)).
needs(visualization, add_object_with_children(kitchen, 0)).
needs(visualization, update_object(cup)).
needs(visualization, update_object_with_children(kitchen)).
needs(visualization, marker_update).
needs(visualization, marker_update(object(cup))).
needs(visualization, marker_update(object(cup), 0)).
needs(visualization, marker_publish).
needs(visualization, marker_touch(object(cup))).
needs(visualization, marker_highlight(object(cup))).
needs(visualization, marker_highlight(object(cup), red)).
needs(visualization, highlight_object(cup)).
needs(visualization, highlight_object(cup, true)).
needs(visualization, highlight_object_with_children(kitchen)).
needs(visualization, marker_highlight_remove(object(cup))).
needs(visualization, marker_highlight_remove).
needs(visualization, reset_highlighting).
needs(visualization, remove_object(cup)).
needs(visualization, remove_object_with_children(kitchen)).
needs(visualization, marker_hide(object(cup))).
needs(visualization, marker_show(object(cup))).
needs(visualization, u_marker_remove_all).
needs(visualization, add_text('hello')).
needs(visualization, add_text('hello', [0, 0, 1], 0.1)).
needs(visualization, marker_text(note, 'hello')).
needs(visualization, add_trajectory(hand, 0, 1, 0.1)).
needs(visualization, add_trajectory(hand, 0, 1, 0.1, 1)).
needs(visualization, add_avg_trajectory(hand, 0, 1, 0.1, 1)).
needs(visualization, camera_transform([[0, 0, 5], [1, 0, 0, 0]])).
needs(visualization, sem_map_inst(_)).
needs(visualization, connect_to_db('episodes')).
needs(visualization, u_load_episodes('episodes')).
needs(visualization, ep_inst(_)).
needs(visualization, u_occurs(_, _, _, _)).
needs(visualization, belief_parse('belief.owl')).
needs(learning, classifier_trained(_, _, _, _)).
needs(learning, classify_instances(_, _, _)).
needs(learning, best_location_dtree(cup, _)).
needs(learning, best_location_maxMaxWup(cup, _)).
needs(learning, best_location_maxMaxWup(cup, _, _)).
needs(learning, rdf_wup_similarity(cup, mug, _)).
needs(export, export_object(cup, 'cup.owl')).
needs(export, export_map(kitchen, 'kitchen.owl')).
needs(export, export_action(pick, 'pick.owl')).
needs(robots, cap_available_on_robot(_, _)).
needs(robots, comp_type_available(_, _)).
