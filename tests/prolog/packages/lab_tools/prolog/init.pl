%% initialization of the package
:- register_ros_package(knowrob_common).
:- register_ros_package(knowrob_objects).
:- register_ros_package(lab_tools).
:- use_module(library('lab_tools')).
:- owl_parser:owl_parse('package://lab_tools/owl/lab_tools.owl').
:- rdf_db:rdf_register_ns(lab, 'http://example.org/lab.owl#', [keep(true)]).
:- rdf_db:rdf_register_prefix(labmap, 'http://example.org/labmap.owl#', [keep(true), force(true)]).
