% How a package of KnowRob begins: its packages, prefixes, messages and tests.

:- register_ros_package(shelf_tools).
:- register_ros_package(shelf_tools, _).
:- use_ros_module(shelf_tools, '/shelf.pl').
:- ros_package_iri(shelf_tools, 'package://shelf_tools/owl').
:- use_directory('../../shelf_tools/src').
:- log_info(shelf(started)), log_debug(shelf(details)), log_warning(shelf(nearly_full)), log_message(warning, shelf(full)).

package_file(File) :- rospack_package_path(shelf_tools, Folder), atom_concat(Folder, '/owl/home.ttl', File).

:- begin_rdf_tests(packages_2, 'package://shelf_tools/owl/home.ttl', [namespace('http://example.org/home.owl#')]).
test('a teapot is a vessel') :- once(has_type(test:best, test:'Vessel')).
:- end_rdf_tests(packages_2).

:- begin_rdf_tests(packages_1, 'package://shelf_tools/owl/home.ttl').
test(the_lid_is_a_class) :- is_class('http://example.org/home.owl#Lid').
:- end_rdf_tests(packages_1).

:- begin_tests(packages).
test(the_folder_is_found) :- package_file(File), exists_file(File).
test(by_its_other_name) :- rospack_package_path(shelf_tools, Folder), ros_package_path(shelf_tools, Folder).
test(shelves_are_counted, true(Number == 3)) :- shelves(cupboard, Number).
test(the_interface_is_implemented, all(Shelf == [top])) :- free_shelf(Shelf).
test(errors_are_printed) :- log_error(shelf(fallen_down)).
:- end_tests(packages).
